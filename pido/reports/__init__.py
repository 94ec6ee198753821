"""Pages that a plant engineer reads, prints and opens offline; each is one self-contained HTML file."""
