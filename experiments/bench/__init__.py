"""The published network's speed and memory beside the same network in other frameworks."""
