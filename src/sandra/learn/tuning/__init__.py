"""Models are trained on rows of prompt and ranking: here, or at a provider's."""
