//! Names in requests that are misspelled: the answer asks about the one that was meant.

use serde_json::json;

use super::api::Api;

#[tokio::test]
async fn requests_are_asked_back_in_the_same_words() {
    let api = Api::start().await;
    let mesh = api.mesh().await;
    let refused = api.post_json("/api/v1/jobs", &json!({"mesh_id": mesh, "params": {"selection": {"targt": 0.9}}})).await;
    assert!(refused.text().contains("did you mean `target`?"), "{}", refused.text());
    let refused = api.post_json("/api/v1/jobs", &json!({"mesh_id": mesh, "cell": "e5-transcan"})).await;
    assert!(refused.text().contains("did you mean e05-transcan?"), "{}", refused.text());
}
