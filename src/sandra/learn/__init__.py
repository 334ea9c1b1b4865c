"""Data to learn from: recorded traffic, prompts with labels, what trainers read of them."""
