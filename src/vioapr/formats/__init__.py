"""Foreign trajectory formats, one module each; conventions are converted here only.

Its face: `registry` (reading and writing a file of any format), `conversion`, `inspection`,
`stated_sigmas`, and `base` for a new format.
"""
