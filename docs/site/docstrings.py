"""Extension of Griffe: docstrings of this package in the form that mkdocstrings renders."""

import re

import griffe

ROLE = re.compile(r":(?:attr|class|data|func|meth|mod):`~?([\w.]+)`")
LITERAL_BLOCK = re.compile(r"^ *::\n", re.MULTILINE)
TABLE = re.compile(r"^=+ +=+\n(.*?)^=+ +=+$", re.MULTILINE | re.DOTALL)
EXAMPLE = re.compile(r"^( *)Example:$", re.MULTILINE)


def as_list(table):
    """Return the rows of a table as a list; a line that begins with a space continues its row."""
    rows = re.sub(r"\n +", " ", table[1]).splitlines()
    return "\n".join("- " + re.sub(r" {2,}", ": ", row, count=1) for row in rows)


class Docstrings(griffe.Extension):
    """Rewrites all docstrings, and leaves out the checks of dataclasses.

    References become code, ``Example`` the section ``Examples``, a table of two columns a list.
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
                text = TABLE.sub(as_list, LITERAL_BLOCK.sub("", text))
                obj.docstring.value = EXAMPLE.sub(r"\1Examples:", text)
            getattr(obj, "members", {}).pop("__post_init__", None)
            for member in getattr(obj, "members", {}).values():
                rewrite(member)

        rewrite(pkg)
