"""Pictures: scenes in MuJoCo, drawn top views, videos."""
