"""What is simulated: parameters and their dimensionless form, closed forms, variables, status."""
