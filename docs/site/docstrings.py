"""Extension of Griffe: docstrings of this package in the form that mkdocstrings renders."""

import re

import griffe

ROLE = re.compile(r":(?:attr|class|data|func|meth|mod):`~?([\w.]+)`")
LITERAL_BLOCK = re.compile(r"^ *::\n", re.MULTILINE)
TABLE = re.compile(r"^=+ +=+\n(.*?)^=+ +=+$", re.MULTILINE | re.DOTALL)
EXAMPLE = re.compile(r"^( *)Example:$", re.MULTILINE)


class Docstrings(griffe.Extension):
    """Rewrites all docstrings, and leaves out the checks of dataclasses.

    References become code, ``Example`` the section ``Examples``, a table text of fixed width.
    """

    def on_package(self, *, pkg, **_):
        """Rewrite the docstrings of a package."""
        seen = set()

        def rewrite(obj):
            if obj.is_alias or obj.path in seen:
                return
            seen.add(obj.path)
            if obj.docstring is not None:
                text = ROLE.sub(r"`\1`", obj.docstring.value)
                text = TABLE.sub(r"```text\n\1```", LITERAL_BLOCK.sub("", text))
                obj.docstring.value = EXAMPLE.sub(r"\1Examples:", text)
            getattr(obj, "members", {}).pop("__post_init__", None)
            for member in getattr(obj, "members", {}).values():
                rewrite(member)

        rewrite(pkg)
