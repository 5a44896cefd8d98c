"""What a deliverable must not give away: unmarked meshes and copies of unmarked points."""
