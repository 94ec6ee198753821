"""The plant: the same services as processes (`make plant`) or containers (`docker-compose.yml`), one settings file."""
