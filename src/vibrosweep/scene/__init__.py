"""From keywords, a mapping or a sweep file to checked, frozen descriptions of a computation."""
