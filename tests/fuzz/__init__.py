"""Damaged files for every reader: they are read, or refused with an InputError."""
