"""Training of language models on rows of prompt and ranking (`sandra finetune`)."""
