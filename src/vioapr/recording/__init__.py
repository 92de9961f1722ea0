"""What a phone captured, and walks that are simulated."""
