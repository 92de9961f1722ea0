"""A simulated place: a courtyard that is rendered, walked and written as a scene."""
