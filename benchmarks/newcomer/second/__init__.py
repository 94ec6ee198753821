"""The second edition: further machines, further part programs, further laws that no mechanism of the vocabulary says.

`machines` and `toolpaths` move; `plain`, `shaped` and `remembered` are the laws; `textbook` is what they are held
against. All else is the first edition's.
"""
