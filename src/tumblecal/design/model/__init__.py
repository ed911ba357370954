"""What a head can measure, and the covariance of the parameters that a schedule on it determines."""
