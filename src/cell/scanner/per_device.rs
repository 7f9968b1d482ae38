//! Values that each optical device of a scanner has one of.

use std::ops::{Index, IndexMut};

use super::DeviceName;

/// One value for each of the three optical devices, in the order left camera, right camera, projector.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PerDevice<T> {
    /// The left camera's.
    pub left: T,
    /// The right camera's.
    pub right: T,
    /// The projector's.
    pub projector: T,
}

impl<T> PerDevice<T> {
    /// One value for both cameras, and the projector's own.
    pub fn of_cameras(camera: T, projector: T) -> Self
    where
        T: Clone,
    {
        Self { left: camera.clone(), right: camera, projector }
    }

    /// Values that `of` makes for each device, in their order.
    #[inline]
    pub fn from_fn(mut of: impl FnMut(DeviceName) -> T) -> Self {
        Self { left: of(DeviceName::Left), right: of(DeviceName::Right), projector: of(DeviceName::Projector) }
    }

    /// Values that `of` makes of these, in their order.
    #[inline]
    pub fn map<U>(self, mut of: impl FnMut(T) -> U) -> PerDevice<U> {
        PerDevice { left: of(self.left), right: of(self.right), projector: of(self.projector) }
    }

    /// References to the values.
    #[inline]
    pub fn as_ref(&self) -> PerDevice<&T> {
        PerDevice { left: &self.left, right: &self.right, projector: &self.projector }
    }

    /// Pairs of these values and the other ones, device by device.
    #[inline]
    pub fn zip<U>(self, other: PerDevice<U>) -> PerDevice<(T, U)> {
        PerDevice {
            left: (self.left, other.left),
            right: (self.right, other.right),
            projector: (self.projector, other.projector),
        }
    }

    /// The cameras' values, the left one's first.
    #[inline]
    pub fn cameras(&self) -> [&T; 2] {
        [&self.left, &self.right]
    }

    /// Iterates over the values in their order.
    #[inline]
    pub fn iter(&self) -> std::array::IntoIter<&T, 3> {
        self.into_iter()
    }
}

impl<T> IntoIterator for PerDevice<T> {
    type Item = T;
    type IntoIter = std::array::IntoIter<T, 3>;

    #[inline]
    fn into_iter(self) -> Self::IntoIter {
        [self.left, self.right, self.projector].into_iter()
    }
}

impl<'a, T> IntoIterator for &'a PerDevice<T> {
    type Item = &'a T;
    type IntoIter = std::array::IntoIter<&'a T, 3>;

    #[inline]
    fn into_iter(self) -> Self::IntoIter {
        self.as_ref().into_iter()
    }
}

impl<T> Index<DeviceName> for PerDevice<T> {
    type Output = T;

    // Kernels index with a name that is known when they are compiled: nothing is left of the match there.
    #[inline(always)]
    fn index(&self, device: DeviceName) -> &T {
        match device {
            DeviceName::Left => &self.left,
            DeviceName::Right => &self.right,
            DeviceName::Projector => &self.projector,
        }
    }
}

impl<T> IndexMut<DeviceName> for PerDevice<T> {
    #[inline(always)]
    fn index_mut(&mut self, device: DeviceName) -> &mut T {
        match device {
            DeviceName::Left => &mut self.left,
            DeviceName::Right => &mut self.right,
            DeviceName::Projector => &mut self.projector,
        }
    }
}
