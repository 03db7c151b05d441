"""Recognition of the target that pictures show, from all of them together.

`look` says what one picture shows (markers, discs, a checkerboard), `layout` turns markers into a board, and
`decide` makes one answer of what all pictures show.
"""
