"""Worker processes, and what they keep out of memory."""
