"""Speed and memory of the published network, compared with other frameworks."""
