"""The figures and claims of Bapat (1995), computed again."""
