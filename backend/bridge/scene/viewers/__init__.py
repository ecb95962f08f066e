"""Who views the scene: the camera, the control and the clicks of each viewer. It draws nothing and knows no sockets."""
