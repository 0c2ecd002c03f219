"""The vocabulary of causes: one record a mechanism, its law, parameters, words, equation and source."""
