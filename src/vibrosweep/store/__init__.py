"""Result files: netCDF-4 written chunk by chunk, and opened again."""
