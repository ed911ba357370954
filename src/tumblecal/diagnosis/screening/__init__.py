"""From readings to explanations, under the noise assumed and under others."""
