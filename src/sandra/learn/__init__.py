"""Data to learn from: recorded traffic, what was driven as labels, prompts, what trainers read."""

from sandra.learn.labels import LABELERS, Label, label

__all__ = ["LABELERS", "Label", "label"]
