"""Light fields to learn from and to try things on: procedural scenes, and the bundled sample."""
