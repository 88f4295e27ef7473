"""Contacts that are learned: the data set, the model, its training, and the informed half of Algorithm 3."""
