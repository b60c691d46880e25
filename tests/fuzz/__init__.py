"""Damaged input of every kind: read, or refused by an error of the project."""
