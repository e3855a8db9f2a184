"""Checked, frozen descriptions of a computation, from keywords, a mapping or a sweep file."""
