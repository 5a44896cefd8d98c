"""Hooks of publishing pipelines: each marks what is published, or keeps it from being published."""
