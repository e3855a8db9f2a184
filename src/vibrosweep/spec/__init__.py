"""A sweep file to one checked, frozen description; designs and tables of realizations."""
