"""The offline side: what is found in, or made of, a whole clip."""
