"""Recognition of the target in a set of pictures, from all of them jointly.

`look` determines what one picture shows (markers, discs, a checkerboard), `layout` derives a board from markers, and
`decide` combines the results of all pictures into one answer.
"""
