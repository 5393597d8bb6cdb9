//! Fitting: observations, initialisation (paper 3.4-3.5), weights, solvers, objectives (paper 3.6), uncertainty.
