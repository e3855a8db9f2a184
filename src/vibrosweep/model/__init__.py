"""The model: parameters and their dimensionless form, closed forms, variables, status."""
