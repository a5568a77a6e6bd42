"""From a specification and effects to something that steps: the only integrator, trajectories, controllers."""
