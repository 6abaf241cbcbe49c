use crate::encoding::encode_response;
use axum::{
    http::{StatusCode, header},
    response::{IntoResponse, Response},
};
use serde::Serialize;
use std::{collections::BTreeMap, sync::Arc};

/// A mesh of an arm, served as `/meshes/<id>`. A description without meshes is drawn from its primitive shapes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct MeshFile {
    /// As the description gives it.
    pub address: String,
    /// Hash of the content: two arms may have other meshes at one address.
    pub id: String,
    /// The content: STL.
    #[serde(skip)]
    #[cfg_attr(feature = "ts", ts(skip))]
    pub bytes: Arc<[u8]>,
}

/// Meshes by their hashes.
pub(crate) type MeshesById = BTreeMap<String, Arc<[u8]>>;

/// By hash what the pages may ask for.
pub(crate) fn meshes_by_id<'a>(meshes: impl IntoIterator<Item = &'a MeshFile>) -> MeshesById {
    meshes.into_iter().map(|mesh| (mesh.id.clone(), Arc::clone(&mesh.bytes))).collect()
}

/// The answer to a page that asks for the mesh `id`.
pub(crate) fn respond(found: Option<Arc<[u8]>>, id: &str, gzip: bool) -> Response {
    let Some(bytes) = found else {
        return (StatusCode::NOT_FOUND, format!("there is no mesh {id} here\n")).into_response();
    };
    // The address is a hash of the content: what it serves never changes.
    let headers = [
        (header::CONTENT_TYPE, "model/stl"),
        (header::CACHE_CONTROL, "max-age=31536000, immutable"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    ];
    encode_response(headers, &bytes, gzip)
}
