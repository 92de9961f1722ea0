"""The server of a folder of scenes: takes captures in, gives out localizers, runs verbs as jobs.

docs/reference/server.md describes its HTTP interface. Needs the extra `web`.
"""
