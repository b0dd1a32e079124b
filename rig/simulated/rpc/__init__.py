"""NI's DAQmx service on the virtual device, as the NI gRPC Device Server answers it."""
