"""Report on estimates as one HTML file, which needs no server and no network."""
