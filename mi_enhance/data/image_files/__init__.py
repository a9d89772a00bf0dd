"""Photographs from files as linear RGB: EXR, PNG and JPEG, or a sentence that says what is wrong."""
