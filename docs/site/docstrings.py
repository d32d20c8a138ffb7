"""Extension of Griffe: docstrings of this package in the form that mkdocstrings renders."""

import re

import griffe

ROLE = re.compile(r":(?:attr|class|data|func|meth|mod):`~?([\w.]+)`")
LITERAL_BLOCK = re.compile(r"^ *::\n", re.MULTILINE)
EXAMPLE = re.compile(r"^( *)Example:$", re.MULTILINE)


class Docstrings(griffe.Extension):
    """Rewrites all docstrings: references become code, ``Example`` the section ``Examples``."""

    def on_package(self, *, pkg, **_):
        """Rewrite the docstrings of a package."""
        seen = set()

        def rewrite(obj):
            if obj.is_alias or obj.path in seen:
                return
            seen.add(obj.path)
            if obj.docstring is not None:
                text = ROLE.sub(r"`\1`", obj.docstring.value)
                obj.docstring.value = EXAMPLE.sub(r"\1Examples:", LITERAL_BLOCK.sub("", text))
            for member in getattr(obj, "members", {}).values():
                rewrite(member)

        rewrite(pkg)
