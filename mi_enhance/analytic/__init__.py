"""The analytic model as a computational graph (section 3 of the paper)."""
