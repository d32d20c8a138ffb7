"""The command line: parse, call the library, print.

Exit codes: 0 all went well; 1 some of several scenes failed; 2 the input cannot be used.
"""

from occjax.cli.main import main

__all__ = ["main"]
