"""Readers: pictures, tables of points, configuration."""
