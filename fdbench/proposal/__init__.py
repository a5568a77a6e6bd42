"""A first mapping file and a first model from an unedited log, with a reason for each guess."""

from fdbench.proposal._proposal import Proposal, propose

__all__ = ["Proposal", "propose"]
