"""From a command to its outputs: recipe -> stage -> stored artefacts -> report and recording."""
