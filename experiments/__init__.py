"""One script per table or figure; each opens with its command, its cost and what to expect."""
