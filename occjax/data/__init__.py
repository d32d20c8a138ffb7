"""Training data: procedural light fields, pools, folders of scenes, and the bundled sample."""
