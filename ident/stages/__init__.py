"""One stage, one file, one public function; a stage returns results and writes nothing."""
