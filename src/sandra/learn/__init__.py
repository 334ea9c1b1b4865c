"""What people drove, as action pairs: labels of recorded trajectories."""

from sandra.learn.labels import LABELERS, Label, label

__all__ = ["LABELERS", "Label", "label"]
