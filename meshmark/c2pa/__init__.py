"""Content credentials (C2PA): a signed sidecar says of a file that it is marked."""
