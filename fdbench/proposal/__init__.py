"""A first mapping file and a first model from an unedited log, with a reason for each guess."""

from fdbench.proposal._proposal import Proposal, of_mapping, propose

__all__ = ["Proposal", "of_mapping", "propose"]
