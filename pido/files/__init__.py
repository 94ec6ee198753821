"""Values of the method as files, bit for bit and without pickle: samples and fitted equations."""
