"""Decks of Abaqus and CalculiX as scenes: a table of cards, a function that translates each, the scene as text."""
