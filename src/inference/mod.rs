//! What choices say about the parameters of a model.
