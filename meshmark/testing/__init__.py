"""Conformance suites a plugin author subclasses, and meshes to test on."""
