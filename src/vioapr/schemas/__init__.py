"""Typed records of every JSON and TOML file that crosses a border."""
