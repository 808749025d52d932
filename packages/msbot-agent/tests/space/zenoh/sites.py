"""Where the router of these tests is."""

HERE = "tcp/127.0.0.1:7447"
SECURE = "tls/127.0.0.1:7448"
