"""Parameters of a scene from measured data: the data (``data``), what a scene predicts of them (``prediction``), the
fit (``study``), and its result (``report``)."""
