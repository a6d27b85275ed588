"""Methods of integration behind one protocol, one heavy library each. Imports cases, models and
schema; knows neither files nor what a motion is wanted for."""
