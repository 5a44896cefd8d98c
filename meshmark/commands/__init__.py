"""What the commands beside embed and verify do."""
