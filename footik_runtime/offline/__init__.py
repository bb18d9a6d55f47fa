"""The offline side: what prepares, cleans and measures whole clips. The runtime never needs it."""
