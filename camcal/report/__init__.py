"""A solution as a plain document, its YAML and JSON, and the table for the terminal."""
