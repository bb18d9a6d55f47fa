"""Commands: what `footik` does, a module each."""
