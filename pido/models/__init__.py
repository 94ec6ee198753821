"""One machine-learning model per axis, what it is measured by, and when it may replace its predecessor."""
