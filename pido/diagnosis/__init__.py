"""Where simulation and recording differ, which physics that is, and proof on data that the fit had not seen."""
