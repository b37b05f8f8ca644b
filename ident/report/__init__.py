"""What the user sees: HTML pages, a recording and text, drawn from stored results without computing again.

Two layers: numbers are gathered into plain arrays (``condense``, ``responses``, ``residuals``), then drawn
(``figures``, ``pages``, ``html``, ``recording``).
"""
