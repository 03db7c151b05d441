"""A solution as one plain document, its YAML and JSON, and the table for people."""
