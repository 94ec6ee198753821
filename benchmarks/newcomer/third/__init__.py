"""The third edition: machines, part programs, laws outside the vocabulary and forms of those in it that no other has.

`machines` and `toolpaths` move; `mechanics`, `guides`, `drives` and `cuts` are the laws outside; `forms` are the named
ones in further forms of the textbooks; `regions` are where a law is confined to. All else is the first edition's.
"""
