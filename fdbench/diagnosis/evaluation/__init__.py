"""How well models predict records: in closed loop, by inverse dynamics, and one sample ahead."""
