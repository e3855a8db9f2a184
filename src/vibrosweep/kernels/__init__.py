"""Compiled kernels: numbers in, numbers out; no files, no datasets, no configuration."""
