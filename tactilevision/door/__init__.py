"""The one door for files: every path, size, shape and number that a file states is checked here, once.

Readers behind it trust what they get. Errors are InputError, with the file, the value and the remedy.
"""
