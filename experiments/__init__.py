"""The paper's tables and figures, one script each; a script starts with its command and cost."""
