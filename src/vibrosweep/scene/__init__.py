"""Keywords, a mapping or a sweep file to checked, frozen descriptions of what is computed."""
