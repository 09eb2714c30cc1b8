"""The work models (Ikeuchi 1987, sec. 2.1.3): the same functions measure a model view and an image region."""
