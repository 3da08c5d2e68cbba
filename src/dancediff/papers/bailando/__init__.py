"""Bailando: dances as words of a learned vocabulary, chosen one after the other."""
