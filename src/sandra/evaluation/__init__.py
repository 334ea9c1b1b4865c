"""What is measured, over many scenes and decisions: costs, verdicts, soundness."""
