//! One SSLBP port: COMMAND, DATA, CS and interface registers.
