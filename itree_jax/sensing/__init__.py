"""From files of images, lights and depth to needles, edges and regions (Ikeuchi 1987, sec. 3.1)."""
