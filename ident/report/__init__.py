"""What the user sees: HTML pages, a recording and text, drawn from stored results without computing again.

Two layers: numbers are gathered into plain arrays (``condense``, ``responses``, ``residuals``), then drawn
(``figures``, ``pages``, ``html``, ``recording``). A stage joins the report with one module in ``pages``: a
function that makes a ``Page`` of blocks (``page``) from the stage's result and tables.
"""
