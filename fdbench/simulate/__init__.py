"""From a specification and effects to something that steps: one lifecycle of all simulators, a stepper for each kind."""
