"""Materials judged (section 7 of the paper): image metrics, scenes, comparisons, physical checks."""
