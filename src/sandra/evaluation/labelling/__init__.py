"""Labels of many scenarios, with nothing dropped."""

from sandra.evaluation.labelling.batch import Choice, label_all
from sandra.evaluation.labelling.summary import Labels

__all__ = ["Choice", "Labels", "label_all"]
