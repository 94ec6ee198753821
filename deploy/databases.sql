-- One database each, at the first start of the container. `make plant` makes the same three (deploy/settings.py).
CREATE DATABASE prefect;
CREATE DATABASE mlflow;
CREATE DATABASE mlflow_auth;
