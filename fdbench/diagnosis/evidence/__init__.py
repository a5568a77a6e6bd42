"""What records and simulations differ by, in units of the noise."""
