"""The published numbers, as data: Ströbel et al., physics-informed dataset optimization (PiDO).

In:  nothing. Out: tables as printed, in A and percent; a report puts ours beside them.
"""

from __future__ import annotations

from types import MappingProxyType

AXES = ("x", "y", "z", "sp")

IMPORTANT_INPUT = MappingProxyType({"x": ("v_x",), "y": ("v_y",), "z": ("mrr_sim",), "sp": ("mrr_sim",)})
"""Figure 4, in words of section III-D: what matters most to each current on the gear in aluminium and steel."""

TABLE_2: dict[str, dict[str, tuple[float, float, float, float]]] = {
    "alpha": {
        "x": (0.7539, 0.0976, 0.4556, 0.6848),
        "y": (0.8078, 0.0701, 0.3336, 0.7836),
        "z": (0.8758, 0.1126, 0.6269, 0.7465),
        "sp": (0.8139, 0.0826, 0.3730, 0.7769),
    },
    "beta": {
        "x": (0.2020, 0.0200, 0.0313, 0.2364),
        "y": (0.2212, 0.0170, 0.0325, 0.2471),
        "z": (0.1641, 0.0130, 0.0133, 0.2136),
        "sp": (0.2395, 0.0170, 0.0304, 0.2704),
    },
    "sigma": {
        "x": (3.3809, 4.8381, 3.7711, 1.3052),
        "y": (3.1811, 4.8086, 3.5114, 1.4255),
        "z": (3.2309, 4.8327, 3.5329, 1.3410),
        "sp": (2.9423, 4.7882, 3.1845, 1.5635),
    },
}
"""Parameter -> axis -> (mean, modal value, median, standard deviation)."""

TABLE_3: dict[int, tuple[float, float, float, float]] = {
    1: (0.131068, 0.036838, 1.472389, 13.312309),
    2: (0.133493, 0.192792, 1.470333, 12.186990),
    3: (0.141676, 0.230116, 1.463374, 11.901897),
    4: (0.141752, 0.234954, 1.463309, 11.864446),
    5: (0.141753, 0.235201, 1.463309, 11.862530),
    6: (0.141822, 0.235233, 1.463249, 11.862281),
    7: (0.141827, 0.236800, 1.463246, 11.850110),
}
"""Order of the polynomial -> (R² PiA, R² PiE, RMSE PiA, RMSE PiE), RMSE in percent of the target density."""

DISTANCE_CORRELATION: dict[str, tuple[float, float]] = {"real share": (0.6832, 0.4552), "Wasserstein": (0.2830, 0.2185)}
"""Section VI-B: (PiA, PiE) against the share of real rows, and against the distance of the training set."""

WASSERSTEIN: dict[str, float] = {
    "DAL_GN": 5.730, "DST_GSFl": 14.803, "DST_PDl": 32.948, "DST_PN": 52.602, "DST_GSF": 62.066,
    "DST_PSFh": 76.161, "DST_GSFh": 83.051, "DST_PDh": 113.471, "DST_GDh": 125.544,
}  # fmt: skip
"""Section IV-C: distance of the nine training sets to DAL_GSFl."""

TABLE_4: dict[str, dict[str, tuple[float, float]]] = {
    "global": {"x": (0.9726, 0.2077), "y": (0.9286, 0.1657), "z": (1.0053, 0.0718), "sp": (3.0344, 0.4479)},
    "local": {"x": (0.3029, 0.9232), "y": (0.2340, 0.9470), "z": (0.3378, 0.8952), "sp": (1.7297, 0.8206)},
}
"""Equation -> axis -> (RMSE in A, R²)."""

TABLE_5: dict[str, dict[str, dict[str, tuple[float, float]]]] = {
    "DMC": {
        "x": {"real": (0.26650, 0.03795), "PiA": (0.26662, 0.03862), "PiE": (0.26428, 0.03699), "PiA+PiE": (0.26450, 0.03696)},  # noqa: E501
        "y": {"real": (0.17373, 0.05053), "PiA": (0.17376, 0.05069), "PiE": (0.17119, 0.04879), "PiA+PiE": (0.17124, 0.04870)},  # noqa: E501
        "z": {"real": (0.05500, 0.02300), "PiA": (0.05488, 0.02291), "PiE": (0.05467, 0.02280), "PiA+PiE": (0.05450, 0.02287)},  # noqa: E501
        "sp": {"real": (0.37285, 0.04237), "PiA": (0.37265, 0.04235), "PiE": (0.37099, 0.04135), "PiA+PiE": (0.37091, 0.04130)},  # noqa: E501
    },
    "CMX": {
        "x": {"real": (0.12971, 0.05017), "PiA": (0.13000, 0.04959), "PiE": (0.12947, 0.04849), "PiA+PiE": (0.12946, 0.04721)},  # noqa: E501
        "y": {"real": (0.13636, 0.06196), "PiA": (0.13543, 0.05934), "PiE": (0.13523, 0.05936), "PiA+PiE": (0.13504, 0.05783)},  # noqa: E501
        "z": {"real": (0.12596, 0.05564), "PiA": (0.12578, 0.05556), "PiE": (0.12581, 0.05532), "PiA+PiE": (0.12532, 0.05506)},  # noqa: E501
        "sp": {"real": (0.02527, 0.00701), "PiA": (0.02522, 0.00699), "PiE": (0.02509, 0.00691), "PiA+PiE": (0.02505, 0.00687)},  # noqa: E501
    },
}  # fmt: skip
"""Machine -> axis -> training set -> (RMSE, its standard deviation), A; scenarios 1 and 2 together, space C."""
