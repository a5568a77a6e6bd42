"""A model of the measured rotary servo, without its uncertainty."""

# From free runs of this axis by least squares: A s^2/rad, A s/rad, A; the unit of torque is that of 1 A.
SERVO = """
axis = "rotary"

[plant]
kind = "feed_drive"
travel_rad = 160.0
velocity_limit_rad_per_s = 20.0

[plant.motor]
kind = "torque_motor"
inertia_kg_m2 = 1.9e-4
viscous_friction_Nm_s_per_rad = 3.3e-4

[[plant.effects]]
kind = "coulomb_friction"
coulomb_force_Nm = 0.065
transition_velocity_rad_per_s = 0.05

[simulation]
substeps = 10
"""
