//! Memory and time that the program takes of the machine: of files made to take much, of parts far from the usual size, and of
//! every broken file of the public data set.

mod bad_files;
mod measured;
mod memory;
mod planning;
mod uploads;
