"""A first mapping file and a first model from an unedited log, with a reason for each guess."""

from fdbench.proposal._proposal import Proposal, of_mapping, propose
from fdbench.proposal._tuned_model import TunedModel, of_tuning

__all__ = ["Proposal", "TunedModel", "of_mapping", "of_tuning", "propose"]
