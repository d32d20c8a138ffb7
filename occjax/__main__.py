"""``python -m occjax`` is ``occjax``."""

from occjax.cli import main

if __name__ == "__main__":
    main()
