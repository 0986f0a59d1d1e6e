"""From a pair of images to items: faces, outlines, colours, checks."""
