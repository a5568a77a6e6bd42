"""From a specification and effects to something that steps: one lifecycle, a stepper for each kind of machine."""
